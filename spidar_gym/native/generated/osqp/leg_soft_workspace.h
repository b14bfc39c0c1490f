/* Generated: the workspace of OSQP for leg_soft. */
#ifndef LEG_SOFT_WORKSPACE_H
#define LEG_SOFT_WORKSPACE_H

#include <stddef.h>
#include <stdint.h>
#include "types.h"
#include "algebra_impl.h"
#include "qdldl_interface.h"

typedef struct {
    OSQPSettings settings;
    OSQPFloat sol_x[40];
    OSQPFloat sol_y[48];
    OSQPFloat sol_prim_inf_cert[48];
    OSQPFloat sol_dual_inf_cert[40];
    OSQPSolution sol;
    OSQPInfo info;
    OSQPInt data_P_csc_p[41];
    OSQPInt data_P_csc_i[100];
    OSQPFloat data_P_csc_x[100];
    OSQPCscMatrix data_P_csc;
    OSQPMatrix data_P;
    OSQPInt data_A_csc_p[41];
    OSQPInt data_A_csc_i[128];
    OSQPFloat data_A_csc_x[128];
    OSQPCscMatrix data_A_csc;
    OSQPMatrix data_A;
    OSQPFloat data_q_val[40];
    OSQPVectorf data_q;
    OSQPFloat data_l_val[48];
    OSQPVectorf data_l;
    OSQPFloat data_u_val[48];
    OSQPVectorf data_u;
    OSQPData data;
    OSQPInt linsys_L_p[89];
    OSQPInt linsys_L_i[192];
    OSQPFloat linsys_L_x[192];
    OSQPCscMatrix linsys_L;
    OSQPFloat linsys_Dinv[88];
    OSQPInt linsys_P[88];
    OSQPFloat linsys_bp[88];
    OSQPFloat linsys_sol[88];
    OSQPFloat linsys_rho_inv_vec[48];
    OSQPInt linsys_KKT_p[89];
    OSQPInt linsys_KKT_i[276];
    OSQPFloat linsys_KKT_x[276];
    OSQPCscMatrix linsys_KKT;
    OSQPInt linsys_PtoKKT[100];
    OSQPInt linsys_AtoKKT[128];
    OSQPInt linsys_rhotoKKT[48];
    OSQPFloat linsys_D[88];
    OSQPInt linsys_etree[88];
    OSQPInt linsys_Lnz[88];
    QDLDL_int linsys_iwork[264];
    QDLDL_bool linsys_bwork[88];
    QDLDL_float linsys_fwork[88];
    qdldl_solver linsys;
    OSQPFloat work_rho_vec_val[48];
    OSQPVectorf work_rho_vec;
    OSQPFloat work_rho_inv_vec_val[48];
    OSQPVectorf work_rho_inv_vec;
    OSQPInt work_constr_type_val[48];
    OSQPVectori work_constr_type;
    OSQPFloat work_x_val[40];
    OSQPVectorf work_x;
    OSQPFloat work_y_val[48];
    OSQPVectorf work_y;
    OSQPFloat work_z_val[48];
    OSQPVectorf work_z;
    OSQPFloat work_xz_tilde_val[88];
    OSQPVectorf work_xz_tilde;
    OSQPVectorf work_xtilde_view;
    OSQPVectorf work_ztilde_view;
    OSQPFloat work_x_prev_val[40];
    OSQPVectorf work_x_prev;
    OSQPFloat work_z_prev_val[48];
    OSQPVectorf work_z_prev;
    OSQPFloat work_Ax_val[48];
    OSQPVectorf work_Ax;
    OSQPFloat work_Px_val[40];
    OSQPVectorf work_Px;
    OSQPFloat work_Aty_val[40];
    OSQPVectorf work_Aty;
    OSQPFloat work_delta_y_val[48];
    OSQPVectorf work_delta_y;
    OSQPFloat work_Atdelta_y_val[40];
    OSQPVectorf work_Atdelta_y;
    OSQPFloat work_delta_x_val[40];
    OSQPVectorf work_delta_x;
    OSQPFloat work_Pdelta_x_val[40];
    OSQPVectorf work_Pdelta_x;
    OSQPFloat work_Adelta_x_val[48];
    OSQPVectorf work_Adelta_x;
    OSQPFloat work_D_temp_val[40];
    OSQPVectorf work_D_temp;
    OSQPFloat work_D_temp_A_val[40];
    OSQPVectorf work_D_temp_A;
    OSQPFloat work_E_temp_val[48];
    OSQPVectorf work_E_temp;
    OSQPWorkspace work;
    OSQPSolver solver;
} leg_soft_space;
extern const leg_soft_space leg_soft_SPACE;
static const uint32_t leg_soft_POINTERS[89] = {
    offsetof(leg_soft_space, sol) + offsetof(OSQPSolution, x), offsetof(leg_soft_space, sol) + offsetof(OSQPSolution, y), offsetof(leg_soft_space, sol) + offsetof(OSQPSolution, prim_inf_cert), offsetof(leg_soft_space, sol) + offsetof(OSQPSolution, dual_inf_cert),
    offsetof(leg_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, p), offsetof(leg_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, i), offsetof(leg_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, x), offsetof(leg_soft_space, data_P) + offsetof(OSQPMatrix, csc),
    offsetof(leg_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, p), offsetof(leg_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, i), offsetof(leg_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, x), offsetof(leg_soft_space, data_A) + offsetof(OSQPMatrix, csc),
    offsetof(leg_soft_space, data_q) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, data_l) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, data_u) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, data) + offsetof(OSQPData, P),
    offsetof(leg_soft_space, data) + offsetof(OSQPData, A), offsetof(leg_soft_space, data) + offsetof(OSQPData, q), offsetof(leg_soft_space, data) + offsetof(OSQPData, l), offsetof(leg_soft_space, data) + offsetof(OSQPData, u),
    offsetof(leg_soft_space, linsys_L) + offsetof(OSQPCscMatrix, p), offsetof(leg_soft_space, linsys_L) + offsetof(OSQPCscMatrix, i), offsetof(leg_soft_space, linsys_L) + offsetof(OSQPCscMatrix, x), offsetof(leg_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, p),
    offsetof(leg_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, i), offsetof(leg_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, x), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, L), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, Dinv),
    offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, P), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, bp), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, sol), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, rho_inv_vec),
    offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, KKT), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, PtoKKT), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, AtoKKT), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, rhotoKKT),
    offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, D), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, etree), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, Lnz), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, iwork),
    offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, bwork), offsetof(leg_soft_space, linsys) + offsetof(qdldl_solver, fwork), offsetof(leg_soft_space, work_rho_vec) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_rho_inv_vec) + offsetof(OSQPVectorf, values),
    offsetof(leg_soft_space, work_constr_type) + offsetof(OSQPVectori, values), offsetof(leg_soft_space, work_x) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_y) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_z) + offsetof(OSQPVectorf, values),
    offsetof(leg_soft_space, work_xz_tilde) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_xtilde_view) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_ztilde_view) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_x_prev) + offsetof(OSQPVectorf, values),
    offsetof(leg_soft_space, work_z_prev) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_Ax) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_Px) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_Aty) + offsetof(OSQPVectorf, values),
    offsetof(leg_soft_space, work_delta_y) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_Atdelta_y) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_delta_x) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_Pdelta_x) + offsetof(OSQPVectorf, values),
    offsetof(leg_soft_space, work_Adelta_x) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_D_temp) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_D_temp_A) + offsetof(OSQPVectorf, values), offsetof(leg_soft_space, work_E_temp) + offsetof(OSQPVectorf, values),
    offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, data), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, linsys_solver), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, rho_vec), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, rho_inv_vec),
    offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, constr_type), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, x), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, y), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, z),
    offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, xz_tilde), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, xtilde_view), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, ztilde_view), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, x_prev),
    offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, z_prev), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, Ax), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, Px), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, Aty),
    offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, delta_y), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, Atdelta_y), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, delta_x), offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, Pdelta_x),
    offsetof(leg_soft_space, work) + offsetof(OSQPWorkspace, Adelta_x), offsetof(leg_soft_space, solver) + offsetof(OSQPSolver, settings), offsetof(leg_soft_space, solver) + offsetof(OSQPSolver, solution), offsetof(leg_soft_space, solver) + offsetof(OSQPSolver, info),
    offsetof(leg_soft_space, solver) + offsetof(OSQPSolver, work),
};

#endif
