/* Generated: the workspace of OSQP for stance_soft. */
#ifndef STANCE_SOFT_WORKSPACE_H
#define STANCE_SOFT_WORKSPACE_H

#include <stddef.h>
#include <stdint.h>
#include "types.h"
#include "algebra_impl.h"
#include "qdldl_interface.h"

typedef struct {
    OSQPSettings settings;
    OSQPFloat sol_x[78];
    OSQPFloat sol_y[74];
    OSQPFloat sol_prim_inf_cert[74];
    OSQPFloat sol_dual_inf_cert[78];
    OSQPSolution sol;
    OSQPInfo info;
    OSQPInt data_P_csc_p[79];
    OSQPInt data_P_csc_i[222];
    OSQPFloat data_P_csc_x[222];
    OSQPCscMatrix data_P_csc;
    OSQPMatrix data_P;
    OSQPInt data_A_csc_p[79];
    OSQPInt data_A_csc_i[454];
    OSQPFloat data_A_csc_x[454];
    OSQPCscMatrix data_A_csc;
    OSQPMatrix data_A;
    OSQPFloat data_q_val[78];
    OSQPVectorf data_q;
    OSQPFloat data_l_val[74];
    OSQPVectorf data_l;
    OSQPFloat data_u_val[74];
    OSQPVectorf data_u;
    OSQPData data;
    OSQPInt linsys_L_p[153];
    OSQPInt linsys_L_i[632];
    OSQPFloat linsys_L_x[632];
    OSQPCscMatrix linsys_L;
    OSQPFloat linsys_Dinv[152];
    OSQPInt linsys_P[152];
    OSQPFloat linsys_bp[152];
    OSQPFloat linsys_sol[152];
    OSQPFloat linsys_rho_inv_vec[74];
    OSQPInt linsys_KKT_p[153];
    OSQPInt linsys_KKT_i[750];
    OSQPFloat linsys_KKT_x[750];
    OSQPCscMatrix linsys_KKT;
    OSQPInt linsys_PtoKKT[222];
    OSQPInt linsys_AtoKKT[454];
    OSQPInt linsys_rhotoKKT[74];
    OSQPFloat linsys_D[152];
    OSQPInt linsys_etree[152];
    OSQPInt linsys_Lnz[152];
    QDLDL_int linsys_iwork[456];
    QDLDL_bool linsys_bwork[152];
    QDLDL_float linsys_fwork[152];
    qdldl_solver linsys;
    OSQPFloat work_rho_vec_val[74];
    OSQPVectorf work_rho_vec;
    OSQPFloat work_rho_inv_vec_val[74];
    OSQPVectorf work_rho_inv_vec;
    OSQPInt work_constr_type_val[74];
    OSQPVectori work_constr_type;
    OSQPFloat work_x_val[78];
    OSQPVectorf work_x;
    OSQPFloat work_y_val[74];
    OSQPVectorf work_y;
    OSQPFloat work_z_val[74];
    OSQPVectorf work_z;
    OSQPFloat work_xz_tilde_val[152];
    OSQPVectorf work_xz_tilde;
    OSQPVectorf work_xtilde_view;
    OSQPVectorf work_ztilde_view;
    OSQPFloat work_x_prev_val[78];
    OSQPVectorf work_x_prev;
    OSQPFloat work_z_prev_val[74];
    OSQPVectorf work_z_prev;
    OSQPFloat work_Ax_val[74];
    OSQPVectorf work_Ax;
    OSQPFloat work_Px_val[78];
    OSQPVectorf work_Px;
    OSQPFloat work_Aty_val[78];
    OSQPVectorf work_Aty;
    OSQPFloat work_delta_y_val[74];
    OSQPVectorf work_delta_y;
    OSQPFloat work_Atdelta_y_val[78];
    OSQPVectorf work_Atdelta_y;
    OSQPFloat work_delta_x_val[78];
    OSQPVectorf work_delta_x;
    OSQPFloat work_Pdelta_x_val[78];
    OSQPVectorf work_Pdelta_x;
    OSQPFloat work_Adelta_x_val[74];
    OSQPVectorf work_Adelta_x;
    OSQPFloat work_D_temp_val[78];
    OSQPVectorf work_D_temp;
    OSQPFloat work_D_temp_A_val[78];
    OSQPVectorf work_D_temp_A;
    OSQPFloat work_E_temp_val[74];
    OSQPVectorf work_E_temp;
    OSQPWorkspace work;
    OSQPSolver solver;
} stance_soft_space;
extern const stance_soft_space stance_soft_SPACE;
static const uint32_t stance_soft_POINTERS[89] = {
    offsetof(stance_soft_space, sol) + offsetof(OSQPSolution, x), offsetof(stance_soft_space, sol) + offsetof(OSQPSolution, y), offsetof(stance_soft_space, sol) + offsetof(OSQPSolution, prim_inf_cert), offsetof(stance_soft_space, sol) + offsetof(OSQPSolution, dual_inf_cert),
    offsetof(stance_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, p), offsetof(stance_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, i), offsetof(stance_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, x), offsetof(stance_soft_space, data_P) + offsetof(OSQPMatrix, csc),
    offsetof(stance_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, p), offsetof(stance_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, i), offsetof(stance_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, x), offsetof(stance_soft_space, data_A) + offsetof(OSQPMatrix, csc),
    offsetof(stance_soft_space, data_q) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, data_l) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, data_u) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, data) + offsetof(OSQPData, P),
    offsetof(stance_soft_space, data) + offsetof(OSQPData, A), offsetof(stance_soft_space, data) + offsetof(OSQPData, q), offsetof(stance_soft_space, data) + offsetof(OSQPData, l), offsetof(stance_soft_space, data) + offsetof(OSQPData, u),
    offsetof(stance_soft_space, linsys_L) + offsetof(OSQPCscMatrix, p), offsetof(stance_soft_space, linsys_L) + offsetof(OSQPCscMatrix, i), offsetof(stance_soft_space, linsys_L) + offsetof(OSQPCscMatrix, x), offsetof(stance_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, p),
    offsetof(stance_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, i), offsetof(stance_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, x), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, L), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, Dinv),
    offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, P), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, bp), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, sol), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, rho_inv_vec),
    offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, KKT), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, PtoKKT), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, AtoKKT), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, rhotoKKT),
    offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, D), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, etree), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, Lnz), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, iwork),
    offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, bwork), offsetof(stance_soft_space, linsys) + offsetof(qdldl_solver, fwork), offsetof(stance_soft_space, work_rho_vec) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_rho_inv_vec) + offsetof(OSQPVectorf, values),
    offsetof(stance_soft_space, work_constr_type) + offsetof(OSQPVectori, values), offsetof(stance_soft_space, work_x) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_y) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_z) + offsetof(OSQPVectorf, values),
    offsetof(stance_soft_space, work_xz_tilde) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_xtilde_view) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_ztilde_view) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_x_prev) + offsetof(OSQPVectorf, values),
    offsetof(stance_soft_space, work_z_prev) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_Ax) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_Px) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_Aty) + offsetof(OSQPVectorf, values),
    offsetof(stance_soft_space, work_delta_y) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_Atdelta_y) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_delta_x) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_Pdelta_x) + offsetof(OSQPVectorf, values),
    offsetof(stance_soft_space, work_Adelta_x) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_D_temp) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_D_temp_A) + offsetof(OSQPVectorf, values), offsetof(stance_soft_space, work_E_temp) + offsetof(OSQPVectorf, values),
    offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, data), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, linsys_solver), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, rho_vec), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, rho_inv_vec),
    offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, constr_type), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, x), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, y), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, z),
    offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, xz_tilde), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, xtilde_view), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, ztilde_view), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, x_prev),
    offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, z_prev), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, Ax), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, Px), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, Aty),
    offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, delta_y), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, Atdelta_y), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, delta_x), offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, Pdelta_x),
    offsetof(stance_soft_space, work) + offsetof(OSQPWorkspace, Adelta_x), offsetof(stance_soft_space, solver) + offsetof(OSQPSolver, settings), offsetof(stance_soft_space, solver) + offsetof(OSQPSolver, solution), offsetof(stance_soft_space, solver) + offsetof(OSQPSolver, info),
    offsetof(stance_soft_space, solver) + offsetof(OSQPSolver, work),
};

#endif
